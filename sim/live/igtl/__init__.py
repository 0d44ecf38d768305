"""OpenIGTLink, which 3D Slicer and PLUS speak: RAS millimetres there, the world's metres here.

`messages` says what is sent and understood, `wire` takes messages off a socket and refuses what is malformed, and
`server` serves any number of clients. pyigtl packs and unpacks the messages; its own server is not used, since it
serves one client and checks neither sizes nor checksums.
"""
