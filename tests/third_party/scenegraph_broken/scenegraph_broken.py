"""A plugin that fails on import, as one built for another version would."""

raise ImportError("scenegraph_broken needs a scenegraph of the year 1999")
