"""Features of one view. Plug-ins register under the entry-point group viewsep.descriptors."""
