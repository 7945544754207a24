"""Proxies of objects without an asset: meshes, colliders, and the clipping of estimated volumes."""
