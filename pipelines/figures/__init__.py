"""Counterparts of the SDFDDGI paper's figures, made by one command, each with what is wrong with it."""
