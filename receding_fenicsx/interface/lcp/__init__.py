"""Linear complementarity problems of the contact law."""
