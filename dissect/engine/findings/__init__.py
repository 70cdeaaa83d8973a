"""What deserves attention: the catalogue and the rules that judge."""
