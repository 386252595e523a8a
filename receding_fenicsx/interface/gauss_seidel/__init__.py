"""Gauss-Seidel iteration for one load step (section 2.2 of Ahn & Barber 2008)."""
