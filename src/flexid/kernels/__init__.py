"""Generated, compiled modules: assembled from templates and kept on disk."""
