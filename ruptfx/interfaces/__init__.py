"""What acts on the bodies: faults, sliding, fracture, collisions, attachments, as mechanisms of one contract."""
