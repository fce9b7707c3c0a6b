

@njit(cache=True, error_model="numpy")
def sampled_outputs(sample_time, samples, p, y):
    """Outputs of the loop at every sample, the first at time 0."""
    for place in range(samples.shape[0]):
        outputs(place * sample_time, samples[place], p, y[place])
