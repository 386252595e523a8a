"""Output of a run: figures, pictures of the body, reports; they read records, no mechanics."""
