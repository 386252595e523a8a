"""What acts on the bodies besides the contact.

* :mod:`~receding_fenicsx.scene.acting.tables`: the tables of a scene file.
* :mod:`~receding_fenicsx.scene.acting.validate`: checks of what acts on whole bodies.
"""
