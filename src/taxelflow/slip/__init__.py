"""Slips -> events: contact, release, begin and end of a slip."""
