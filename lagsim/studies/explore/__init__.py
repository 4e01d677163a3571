"""`lagsim explore`: motions of a model at values that somebody sets on a page.

    explorer   motions of one model file for any values, in this process
    dragging   start values that put a point of the scene at a given place
    server     HTTP server of the explorer, for a page in a browser of this machine

The page itself is in `lagsim.outputs.animation`.
"""
