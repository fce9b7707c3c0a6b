"""What a figure shows, described once and drawn by Matplotlib, in a page or in the studio."""
