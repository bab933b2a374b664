"""Binary glTF with an asset's data, and a three.js module that draws it."""
