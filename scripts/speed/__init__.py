"""Speed measurements of the parts, for `endolock benchmark`."""
