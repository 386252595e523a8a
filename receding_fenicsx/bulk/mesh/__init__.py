"""Meshes of the bodies, made by gmsh or read from a file."""
