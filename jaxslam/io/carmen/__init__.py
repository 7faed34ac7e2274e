"""CARMEN text logs."""
