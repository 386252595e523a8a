"""The elastic body: mesh, finite elements, condensation to the contact nodes, back to fields."""

import contextlib

with contextlib.suppress(ImportError):
    # PyPI's stack has to be loaded before mpi4py and petsc4py
    import dolfinx_solver  # noqa: F401
