"""The operator's side: it renders the streamed model locally, so that force never lags."""
