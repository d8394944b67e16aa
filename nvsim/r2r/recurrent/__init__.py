"""The recurrent agent, after VLN↻BERT (Hong et al. 2021), small enough to be trained on a processor: it reads an
instruction, sees candidates of exported scans as features, and keeps what it has done in one state. Draws nothing."""
