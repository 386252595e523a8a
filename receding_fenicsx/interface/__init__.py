"""The frictional contact of a condensed body: NumPy only, no finite elements, no MPI."""
