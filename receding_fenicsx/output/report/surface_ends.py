"""Warning about a half-plane's contact that is cut off by the length of its surface."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.evolution.record import Record


def cut_off_warnings(record: Record) -> list[str]:
    """Return one line where pressure reaches an end of a half-plane's surface with an initial gap.

    Beyond its ends the surface cannot touch: a rounded profile that is pressed further than that
    gets the singular pressures of a punch there. Without an initial gap the end is that of a punch.
    """
    scene = record.scene
    if scene is None or not scene.find_edge(scene.contacts[0].edge)[0].is_half_plane:
        return []
    ends = [0, -1]
    touch = np.any(record.turning_points.P[:, ends] > 0.0, axis=0) & (record.g0[ends] > 0.0)
    places = " and ".join(f"{record.x[end]:g}" for end in np.array(ends)[touch])
    if not places:
        return []
    keys = "width" if scene.contacts[0].span is None else "span"
    return [
        f"the contact reaches the end of the half-plane's surface at x = {places}, beyond which "
        f"nothing can touch; where the profile goes on there, enlarge {keys}"
    ]
