"""Files that other programs write, read by their libraries: one function a format, each in a child.

`formats` registers them, `guard` starts the child and checks what comes back, `child` runs there.
"""
