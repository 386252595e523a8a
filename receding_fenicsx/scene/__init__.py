"""Scenes: the input of a run, its TOML file, validation, load history and symmetry.

A scene describes bodies, materials, mesh, contacts, loads, supports, history and options. It knows
nothing of finite elements. From a file to a history:

1. :func:`~receding_fenicsx.scene.toml_file.read_scene` parses the file.
   :func:`~receding_fenicsx.scene.toml_file.apply_override` applies ``--set table.key=value``,
   and :func:`~receding_fenicsx.scene.column_file.with_files` replaces ``{file = "gap.csv"}`` by the
   table or the rows in that file.
2. :func:`~receding_fenicsx.scene.toml_reader.scene_of` converts the tables into the dataclass
   :class:`~receding_fenicsx.scene.model.Scene`. The types there say what each key may be; Pydantic
   checks them, and all errors are told at once.
3. :func:`~receding_fenicsx.scene.validate.validate` checks the rules between values too, also of a
   scene made in Python. Its parts are :mod:`~receding_fenicsx.scene.validate_bodies` and
   :mod:`~receding_fenicsx.scene.validate_loads`.
   :func:`~receding_fenicsx.scene.validate.scene_warnings` lists options that make results
   inaccurate.
4. :func:`~receding_fenicsx.scene.history.history_from_scene` makes the load history, a
   polyline of load factors.
5. :func:`~receding_fenicsx.scene.symmetry.is_mirror_symmetric` decides whether half of the body is
   modelled. :func:`~receding_fenicsx.scene.one_body.part_of` gives each of several bodies its
   own scene.
6. :func:`~receding_fenicsx.scene.profiles.evaluate` evaluates friction, gap and loads at points;
   :mod:`~receding_fenicsx.scene.symmetry` knows where the points of a rectangle's edges are.
7. :func:`~receding_fenicsx.scene.toml_file.to_toml` writes the scene with the results.
   :func:`~receding_fenicsx.scene.identity.difference` compares it with the scene of a later run.
"""
