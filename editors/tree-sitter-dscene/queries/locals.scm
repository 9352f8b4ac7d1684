[
  (function)
  (native_function)
  (lambda)
  (block)
  (array)
] @local.scope

(let name: (identifier) @local.definition)
(param name: (identifier) @local.definition)
(loss name: (identifier) @local.definition)
(kind name: (identifier) @local.definition)
(function name: (identifier) @local.definition)
(parameter name: (identifier) @local.definition)
(lambda parameters: (identifier) @local.definition)
(lambda_parameters (identifier) @local.definition)
(for name: (identifier) @local.definition)

(identifier) @local.reference
