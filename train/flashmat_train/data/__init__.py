"""Materials on disk to augmented crops: reading and packing, crops, augmentation."""
