"""Observer and closed loops of Huang (2003): declarations, derivation, source and templates."""
