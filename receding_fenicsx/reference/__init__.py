"""Closed forms and published results of known contacts.

* :mod:`closed_forms`: Hertz, Cattaneo and Mindlin, bilateral layers; computed values of pressed
  blocks, layers and punches.
* :mod:`layer`: contact half widths of a layer on a half-plane and of two layers on a plane, by
  singular integral equations.
* :mod:`fretting`: dissipation of sheared cylinders under any history of both forces.
"""

from receding_fenicsx.reference import closed_forms as closed_forms
from receding_fenicsx.reference import fretting as fretting
from receding_fenicsx.reference import layer as layer
