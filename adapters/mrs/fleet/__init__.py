"""Several assets: the directory, what was heard of others, the service layer above."""
