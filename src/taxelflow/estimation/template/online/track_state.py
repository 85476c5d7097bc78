"""What a pad remembers from scan to scan."""

from __future__ import annotations

(
    ACTIVE,  # whether the pad has a pattern
    SPACING,  # lattice, three numbers
    _,
    LOW,
    ROUGH,  # error of the pattern relative to it
    USUAL,  # chi-square per reading that its scans usually leave
    TURN_STD,  # how far theta may move from scan to scan; 0 if it is fixed
    GAIN_STD,  # and the gain
    CHI,  # chi-square per reading of the last scan
    COUNT,  # readings in it
    SPEED_X,  # of the last scan, per s
    SPEED_Y,
    SPEED_T,
    SPAN,  # time from the scan before it
    LAST_T,  # time of the last registered scan
    CENTROID_X,
    CENTROID_Y,
    RADIUS,  # of the pattern
    SHARE,  # of the information on theta that is real, see `poses.to_pad`
    SHARE_OF_PLACE,  # and of that on x and y
    SEEN,  # whether theta is reported
    THETA_0,  # where it counts from
    POOR,  # scans in a row that do not fit
    CONTINUES,  # whether the scan before was registered, on this pattern
    KEYFRAMES,  # how many there are
    SLACK,  # variance of x and y, in pitches^2, from errors of the pattern
    SLACK_T,  # and of theta
    CUT,  # whether this contact has ever been cut by the border
    PROBATION,  # scans for which a recognised pattern is looked for all over the pad
    LOAD,  # sum of the loaded readings, of the last scan
    GROWS,  # whether the contact has been seen to grow with the load
    AWAY,  # how far the object has been from its first keyframe, in pitches
    TURNED,  # whether a scan was explained by a turn although theta was fixed
    PLACE_X,  # where the object has been lately
    PLACE_Y,
    PLACE_T,
    CARRIES,  # whether a rest is carried from scan to scan, see `carry`
    CHANGING,  # whether the pattern does not stay: every scan is learned from, and the old forgotten
    ACROSS_X,  # how far x may be off, in pitches, where it leads across a line of taxels; 0 where it is told
    ACROSS_Y,
    FLAG,  # what the last scan calls for, one of the below
    SLOTS,
) = range(42)
"""Places in a pad's memory."""

NOTHING, NOVEL, GONE = range(3)
"""What a scan calls for: nothing, to be learned from, a new start."""

HUBER = 5.0
"""Standard deviations from which on a reading is held down."""
BLURRED = 0.25
"""A place is known badly from this standard deviation on, in pitches."""
FAINT = 3.0
"""A pattern from scans so many times fainter is not worth keeping."""
