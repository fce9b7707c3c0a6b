"""Code that judges what sensors recorded, sample by sample: see `flexid.kernels.store`."""
