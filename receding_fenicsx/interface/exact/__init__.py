"""Exact evolution along a leg, from one change of state to the next."""
