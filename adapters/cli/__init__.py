"""The command line tool `rover`."""
