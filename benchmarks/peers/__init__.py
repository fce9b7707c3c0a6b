"""Each tool's part of the comparison: one file each, written as a user of that tool would."""
