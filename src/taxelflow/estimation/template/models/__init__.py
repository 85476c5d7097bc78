"""Motion hypotheses besides the rigid pose: which degrees of freedom a contact has."""
