"""Random planar arms, simulated by MuJoCo, and what `flexid identify --model` finds of them."""
