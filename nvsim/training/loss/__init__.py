"""The terms of the floor-aware loss and their gradients. Does not depend on the trainer."""
