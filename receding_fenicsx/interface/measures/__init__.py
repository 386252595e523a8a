"""Quantities read from contact states: zones, tractions, steady state."""
