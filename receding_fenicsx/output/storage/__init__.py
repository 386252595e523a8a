"""Files: HDF5 records and systems, run folders, the FCLIB exchange format."""
