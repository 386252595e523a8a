"""Events, and whole cycles, that have come before: foreseen and verified many at once."""
