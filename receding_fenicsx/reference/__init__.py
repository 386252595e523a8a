"""Closed forms and published results of known contacts."""
