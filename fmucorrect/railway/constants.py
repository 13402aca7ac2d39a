"""Figures that railway dynamics takes as given."""

GRAVITY = 9.81
"""m/s2."""
KMH = 3.6
"""km/h in a m/s."""
CONTACT_SPACING = 1.5
"""m, between the contact points of a wheelset on standard gauge."""
