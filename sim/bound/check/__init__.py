"""The check of a certificate, which shares no solver and no geometry with the code that wrote it."""
