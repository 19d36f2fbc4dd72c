// Generated from runtime/layouts.py by `python -m runtime.structs`: edit the classes instead.
