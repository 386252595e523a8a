r"""Probes: displacements and stresses at points, as linear functions of contact and loads.

A displacement or stress at a point is $g \cdot u$, with few degrees of freedom in $g$
(`points.point_values`). With the interior $I$, the contact $C$ and
$u_I = A_{II}^{-1} (\sum_k \lambda_k f_{k,I} / E - A_{IC} u_C)$,

$$g \cdot u = (g_C - A_{CI} z) \cdot u_C + \sum_k \lambda_k\, z \cdot f_{k,I} / E,
  \qquad A_{II}\, z = g_I ,$$

so that each value costs one solve, made once (`matrix.probe_matrix`), and none for each instant.
"""
