"""What the pages of the console take from npm, kept as files so that no user needs Node."""
