"""Published studies reproduced: their runs and their claims."""
