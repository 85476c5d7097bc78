"""The view in the browser: a hand in 3-D, with panels beside it."""
