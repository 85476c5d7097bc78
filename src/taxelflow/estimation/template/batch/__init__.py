"""The template on a whole recording: initialise, adjust, select the model."""
