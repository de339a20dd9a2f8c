"""A campaign of kill -9 against client, broker and executive, and what must hold afterwards."""
