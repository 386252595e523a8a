r"""The elastic body: mesh, finite elements, condensation to the contact nodes, back to fields.

Displacements $u$ of a linear elastic body with tractions $\lambda_k t_k$ on parts of its boundary
satisfy, for all admissible $\delta u$ and with the reactions $r$ at the contact nodes,

$$\int_\Omega \sigma(u) : \varepsilon(\delta u) \, dV
  = \sum_k \lambda_k \int_{\Gamma_k} t_k \cdot \delta u \, dA + r \cdot \delta u_C ,$$

in plane strain, plane stress, or with $dV = 2 \pi r\, dr\, dz$ and the hoop strain $u_r / r$ for
bodies of revolution. In finite elements this is $A u = \sum_k \lambda_k f_k + r$. With the contact
$C$ and all other degrees of freedom $I$, eliminating $u_I$ gives the paper's eq. (11),

$$r = \sum_k \lambda_k r^*_k + K u_C, \qquad
  K = A_{CC} - A_{CI} A_{II}^{-1} A_{IC}, \qquad
  r^*_k = A_{CI} A_{II}^{-1} f_{k,I} - f_{k,C},$$

in the directions $t$ and $n$ of the contact edge (12). `condensation` lets MUMPS form $K$ while it
factors $A$. Where a picture asks for it, the field comes back by

$$u_I = A_{II}^{-1} \left( \sum_k \lambda_k f_{k,I} - A_{IC} u_C \right) .$$

Tractions are $p_i = P_i / m_i$, $q_i = Q_i / m_i$ with the weight $m_i = \int N_i \, dA$ of a
node's shape function over the contact edge: they keep $|q| \le f p$, which the inverse of the
consistent mass matrix does not.
"""

import contextlib

with contextlib.suppress(ImportError):
    # PyPI's stack has to be loaded before mpi4py and petsc4py
    import dolfinx_solver  # noqa: F401
