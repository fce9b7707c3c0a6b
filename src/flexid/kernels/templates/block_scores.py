"""Normal equations block by block, for the spread of the blocks' scores."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *


@rounded
def store_block(counts, ends, lengths, blocks, block, length, forgetting, longest):
    """Keep the normal equations of one more block; make room first if there is none.

    counts      blocks kept, samples so far, wanted length of a block in samples
    ends        count of samples at the end of each block
    lengths     samples in each block
    blocks      all numbers of the blocks' normal equations, block after block
    block       those of the new one, of the given length
    forgetting  factor of the weight from sample to sample
    longest     length up to which blocks may grow
    """
    kept, size = int(counts[0]), block.shape[0]
    if kept == ends.shape[0]:
        if 2.0 * counts[2] <= longest:  # all in pairs; from now on blocks are twice as long
            counts[2] *= 2.0
            pairs = kept // 2
        else:  # the two oldest, which are next to forgotten
            pairs = 1
        for b in range(kept - pairs):
            fading = 0.0
            first = b + pairs
            if b < pairs:
                first = 2 * b + 1
                fading = forgetting ** (ends[first] - ends[first - 1])
            for i in range(size):
                merged = fading * blocks[(first - 1) * size + i] if b < pairs else 0.0
                blocks[b * size + i] = merged + blocks[first * size + i]
            lengths[b] = lengths[first] + (lengths[first - 1] if b < pairs else 0.0)
            ends[b] = ends[first]
        kept -= pairs
    for i in range(size):
        blocks[kept * size + i] = block[i]
    ends[kept] = counts[1]
    lengths[kept] = length
    counts[0] = kept + 1.0
