r"""Joints: dissipation and stiffness of a preloaded contact over the amplitude of a driven load.

1. :func:`~receding_fenicsx.studies.joint.curve.joint_curve` applies the other loads first and keeps
   them. Then the drive goes between plus and minus each amplitude, to the limit of infinitely many
   cycles (:mod:`receding_fenicsx.evolution.limit`). The amplitudes are cases of
   :mod:`receding_fenicsx.studies.runner`: on many processes or ranks, and resumed.
2. :mod:`~receding_fenicsx.studies.joint.backbone` follows the first loading, finds the amplitude of
   macroslip, beyond which there is no equilibrium, and the dissipation that Masing's rule gives.
3. The curve on a mesh of half as many elements estimates the discretisation error.
4. :mod:`~receding_fenicsx.studies.joint.curve` draws both over the amplitude.
5. :mod:`~receding_fenicsx.modal` makes a vibration mode of the stuck joint its drive.
6. :mod:`~receding_fenicsx.studies.joint.fits` fits models of springs and sliders to a curve.
"""
