"""Runs pieces of work in processes of this machine or on the machines of a Ray cluster. Both have one interface, so a
stage defines its pieces and not where they run. Independent of submaps, frames and projects."""
