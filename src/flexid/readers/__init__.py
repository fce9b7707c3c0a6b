"""Readers of files of other programs: one function per format, run in a child process.

`formats` registers the readers, `guard` starts the child process, `child` is the code in it.
"""
