"""Vibration modes of preloaded contacts, and the loads that drive them quasi-statically."""
