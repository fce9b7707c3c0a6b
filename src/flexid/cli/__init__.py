"""Command line: commands made from the library's functions, and how their answers leave."""
