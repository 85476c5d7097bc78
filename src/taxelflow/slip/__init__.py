"""Slips -> events: contact and slip."""
