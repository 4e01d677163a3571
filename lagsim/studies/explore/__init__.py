"""`lagsim explore`: motions of a model at values that somebody sets on a page.

    engine   the motion of one model file for any values, in this process
    dragging start positions at which a point of the scene is where it was dragged to
    server   the engine behind HTTP, for a page in a browser of this machine

The page itself is in `lagsim.outputs.animation`.
"""
