"""Half-planes of a scene as bodies: contact nodes, far field, pairs, fields in a window.

`body.half_plane_of` places the contact nodes and reads what acts far away; `pair.join_half_planes`
joins two half-planes; `body.HalfPlane` evaluates the fields that pictures and probes show. The
mathematics is in :mod:`receding_fenicsx.half_plane`.
"""
