"""Contact segmentation: split and track the contacts of a pad, check that they are rigid, describe each."""
