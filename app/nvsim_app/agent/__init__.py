"""Walk the graph as an agent: images of 640 x 480 pixels, turns of 30 degrees, steps from viewpoint to viewpoint.

`nvsim.r2r.simulator` runs in a child process and computes the states; this package only shows them. The free walk of
the 3D view is in `nvsim_app.views.navigation`."""
