"""The provider of the MRS: serves one executive."""
