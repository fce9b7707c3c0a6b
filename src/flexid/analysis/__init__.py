"""What a run or a recording can tell: excitation and Lyapunov monitors."""
