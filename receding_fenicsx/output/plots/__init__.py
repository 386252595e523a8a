"""Matplotlib figures of a record."""
