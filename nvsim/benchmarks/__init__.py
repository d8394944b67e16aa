"""Measurements of cost, one file a subject, which `nvsim bench` runs. Nothing but the commands depends on them."""
