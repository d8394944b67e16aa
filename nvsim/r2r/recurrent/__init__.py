"""The recurrent agent, after VLN↻BERT (Hong et al. 2021), small enough to be trained on a CPU.

It reads an instruction, sees candidates of exported scans as features, and keeps its history in one state. Renders no
images.
"""
