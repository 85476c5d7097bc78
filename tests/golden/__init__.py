"""The golden archive: results of every method on fixed recordings, to prove that a refactoring changes none of them."""
