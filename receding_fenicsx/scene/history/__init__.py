"""Load histories: polylines of load factors, from a scene or made directly.

* :mod:`~receding_fenicsx.scene.history.polyline`: a :class:`History`, its legs and instants.
* :mod:`~receding_fenicsx.scene.history.kinds`: the history of a scene, by its kind.
"""

from receding_fenicsx.scene.history.kinds import history_from_scene as history_from_scene
from receding_fenicsx.scene.history.polyline import History as History
from receding_fenicsx.scene.history.polyline import check_history as check_history
from receding_fenicsx.scene.history.polyline import ended_by as ended_by
from receding_fenicsx.scene.history.polyline import evenly_spaced as evenly_spaced
from receding_fenicsx.scene.history.polyline import leg_number as leg_number
