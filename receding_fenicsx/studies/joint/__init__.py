r"""Joints: dissipation and stiffness of a preloaded contact over the amplitude of a driven load.

``curve.joint_curve`` applies the other loads first and keeps them; then the drive goes between plus
and minus each amplitude, to the limit of infinitely many cycles, on two meshes. ``first_loading``
follows it to macroslip, for Masing's rule. :mod:`~receding_fenicsx.modal` makes a vibration mode of
the stuck joint its drive, and ``fits`` fits springs and sliders to a curve.
"""
