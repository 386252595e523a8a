"""Uniqueness of a path."""
