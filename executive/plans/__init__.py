"""Plans: behaviour trees that mission control sends, and what becomes of them."""
