"""The paper's class of systems and its member, the flexible joint."""
