"""Messages -> world: tables, summaries, pictures."""
