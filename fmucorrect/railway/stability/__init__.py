"""Where a vehicle hunts: linearisation, critical speed, limit cycles and their bifurcation."""
