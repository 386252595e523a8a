"""Pictures of stresses on the deformed body, films of a cycle, fields for ParaView.

1. ``draw.snapshots`` solves for the fields of instants, and ``paraview`` writes them.
2. ``view.view_of`` collects mesh, contact and loads in the picture's units.
3. ``page.layout_of`` arranges the page, ``page.colours_of`` chooses the colours.
4. ``render.render`` draws the field with pyvista, ``page.compose`` the page around it.
5. ``draw.draw_mode`` draws the body deformed by the slip mode at critical friction.
6. ``draw.animate`` draws all instants of a cycle and writes MP4 and GIF.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["draw", "page"])
