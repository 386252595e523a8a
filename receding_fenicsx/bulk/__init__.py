r"""Elastic bodies: mesh, finite elements, condensation to the contact nodes, back-substitution.

The displacement $u$ of a linear elastic body with tractions $\lambda_k t_k$ on parts of its
boundary satisfies, for all admissible $\delta u$ and with the reactions $r$ at the contact nodes,

$$\int_\Omega \sigma(u) : \varepsilon(\delta u) \, dV
  = \sum_k \lambda_k \int_{\Gamma_k} t_k \cdot \delta u \, dA + r \cdot \delta u_C ,$$

in plane strain, plane stress, or with $dV = 2 \pi r\, dr\, dz$ and the hoop strain $u_r / r$ for
bodies of revolution. In finite elements this is $A u = \sum_k \lambda_k f_k + r$. With the contact
$C$ and the interior $I$, eliminating $u_I$ gives the paper's eq. (11) in the directions $t$ and $n$
of the contact edge (12),

$$r = \sum_k \lambda_k r^*_k + K u_C, \qquad
  K = A_{CC} - A_{CI} A_{II}^{-1} A_{IC}, \qquad
  r^*_k = A_{CI} A_{II}^{-1} f_{k,I} - f_{k,C}.$$

The steps, of which `from_scene.condensed` and `from_scene.bulk_of` do the first four and two:

1. `mesh.meshing.make_meshes` meshes the bodies, and distributes the meshes.
2. `stack.build_all` assembles each body (`stack.build`): $A$ (`elasticity.stiffness_matrix`), the
   forces $f_k$ (`loads.nodal_forces`), the contact nodes with $t$, $n$ and weights
   $m_i = \int N_i \, dA$ (`contact_nodes.find_contact`), and the constraints $u = P u' + d$ of
   supports, platens and prescribed displacements (`contact_nodes.find_constraints`).
3. `stack.condense` eliminates the interior of each body (`body.factorise`), by MUMPS's
   Schur complement (`schur.factorise`), checks $K$ by a solve and by the rigid motions, joins the
   bodies (`join_bodies.join`), and closes what acts between them: bolts, springs, interference
   (`closures`).
4. The result is an `interface.system.ContactSystem` on rank 0, whose friction and gap
   `evolution.problem.with_profiles` sets.
5. For pictures, `fields.solve_fields` returns to the bodies,
   $u_I = A_{II}^{-1} ( \sum_k \lambda_k f_{k,I} - A_{IC} u_C )$
   (`body.back_substitute`), and evaluates the stresses (`elasticity.stresses`);
   `fields.gather_fields` brings the fields of the whole body to rank 0.

Tractions are $p_i = P_i / m_i$, $q_i = Q_i / m_i$: they keep $|q| \le f p$, which the inverse of
the consistent mass matrix does not. Calls that differ between versions of DOLFINx are in
`_dolfinx`.
"""

import contextlib

with contextlib.suppress(ImportError):
    # h5py's HDF5 does not start after that of PyPI's stack, which has to be loaded before mpi4py
    import h5py  # noqa: F401, I001
    import dolfinx_solver  # noqa: F401
