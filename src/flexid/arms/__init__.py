"""Arms of several elastic joints: from their log to one table per joint."""
