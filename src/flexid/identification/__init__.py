"""The main job: recordings and a model become an estimate."""
