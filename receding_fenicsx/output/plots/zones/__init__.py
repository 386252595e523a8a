"""Zone maps: states of the contact nodes as areas over position and load path.

1. ``timelines`` has the states of each node along a leg; ``zone_map`` makes areas of them, for one
   leg or for all legs of a cycle.
2. ``zone_plots.zone_maps`` draws one panel for each leg, ``cycle_maps.cycle_maps`` one map for each
   cycle with the load factors beside it; ``zone_axes`` draws areas and lines of both,
   ``zone_labels`` places the numbers of states.
"""
