"""Scenes: the input of a run, its TOML file, validation, load history and symmetry.

1. ``toml_file.read_scene`` parses the file; ``apply_override`` applies ``--set table.key=value``,
   and ``profiles.with_files`` replaces ``{file = "gap.csv"}`` by the rows in that file.
2. ``toml_reader.scene_of`` converts the tables into the dataclass ``model.Scene``, whose types,
   there and in ``options``, say what each key may be; Pydantic checks them.
3. ``validate.validate`` checks the rules between values too, also of a scene made in Python.
4. ``history.history_from_scene`` makes the load history, a polyline of load factors.
5. ``symmetry.is_mirror_symmetric`` decides whether half of the body is modelled, and
   ``one_body.part_of`` gives each of several bodies its own scene.
6. ``profiles.evaluate`` evaluates friction, gap and loads at points.
7. ``toml_file.to_toml`` writes the scene with the results; ``identity.difference`` compares it with
   that of a later run.
"""
