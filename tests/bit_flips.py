"""Files that are damaged in one bit."""


def flip_each_bit(path, bits):
    """Writes a file anew with one of its bits flipped, for each of `bits` in turn, which it yields."""
    data = path.read_bytes()
    for bit in bits:
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(flipped)
        yield bit
