"""Code of each compared tool, one file each, written as by a user of that tool."""
