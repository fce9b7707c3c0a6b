"""What a run or a recording shows: excitation and Lyapunov monitors."""
