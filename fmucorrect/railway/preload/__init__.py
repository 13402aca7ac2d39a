"""Preload and static equilibrium: whether a vehicle stands, and carries what it must."""
