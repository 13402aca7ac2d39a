"""What only rail needs: static equilibrium and preload, critical speed, running safety, contact tables."""
