"""Random generators of a recording's parts: none of them changes another one's numbers."""

STICK_SLIP, TEXTURE, JITTER, DRIFT, WOBBLE = range(1, 6)
"""Their numbers, beside the scenario's seed: holds and slips, texture, time stamps, drift rates, common gain."""
