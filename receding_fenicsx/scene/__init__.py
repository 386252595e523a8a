"""Scenes: their dataclasses, TOML files, validation, load histories and symmetry."""
