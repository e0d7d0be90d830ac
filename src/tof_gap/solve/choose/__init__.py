"""Which hypotheses a session supports: scores on held-out views, selection, ties."""
