"""Whole jobs: convert, render, compare; the only package that parses arguments or prints."""
