"""A case without what says whose it is, for handing on."""
