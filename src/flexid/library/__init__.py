"""What `import flexid` offers: every command as a function, and results that one can work with."""
