"""Code that calls generated functions of loops by name: see `flexid.kernels.store`."""
