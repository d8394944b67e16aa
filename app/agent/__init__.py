"""Walking the graph as an agent does: one view of 640 x 480 pixels at a time, in turns of 30 degrees and steps from
viewpoint to viewpoint. The states are those of `nvsim.r2r.simulator`, which runs in a process of its own; nothing of it
is worked out here again. Not the free walk of the 3D view (`app.views.navigation`)."""
